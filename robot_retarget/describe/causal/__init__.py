"""The graph of a motion in progress: the targets at a frame depend only on the frames until then.

`calibration` holds the facts of a whole clip (bone lengths, floor, how joints' axes lie in segments); `human`,
`contacts` and `footholds` advance frame by frame; `wishes` assembles the targets.
"""
