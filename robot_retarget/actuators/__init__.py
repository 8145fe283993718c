"""Servos as data: the map of a robot's servos, the bounds of its values, and the control tables of the data sheets."""
