"""A human motion and a robot as one graph: match the bodies, and set the targets of every pair, bone and segment."""
