"""The graph of a motion that is still going on: what edges ask for at a frame is told by the frames so far.

`calibration` holds what a whole clip would tell (bone lengths, floor, how joints' axes lie in segments); `human`, `contacts`
and `footholds` go on frame by frame; `wishes` puts together what is asked.
"""
