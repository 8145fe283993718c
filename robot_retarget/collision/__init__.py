"""Self-collisions of a trajectory: warned of before they happen, and avoided."""
