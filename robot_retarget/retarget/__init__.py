"""A human motion as a graph on a robot: match the bodies, build the edges, solve for the joints."""
