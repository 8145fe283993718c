"""A human motion and a robot as one graph: match the bodies, say what is wished of every pair, bone and segment."""
