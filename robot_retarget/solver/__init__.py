"""A graph solved for the robot's joints: one frame, a whole clip, or frame by frame."""
