"""The graph of a motion in progress: the targets at a frame depend only on the frames until then.

`calibration` holds what a whole clip would tell (bone lengths, floor, how joints' axes lie in segments); `human`, `contacts`
and `footholds` go on frame by frame; `all_targets` puts together what is asked.
"""
