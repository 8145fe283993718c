"""A trajectory that stands: footholds, centre of mass and timing of a robot on its own feet."""
