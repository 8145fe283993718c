"""Features of a human motion: floor, contact schedule, axes of segments, activity.

`features` reads a whole clip. `causal` reads a stream frame by frame from the constants of a calibration. Both name the
parts of the body by the keypoints of `match`, which human and robot share.
"""
