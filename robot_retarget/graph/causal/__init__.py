"""The graph of a motion in progress: the targets at a frame depend only on the frames until then.

`calibration` holds the constants of a performer (bone lengths, floor, axes of joints in segments). `human`, `contacts` and
`footholds` are updated frame by frame. `targets` joins the targets of all kinds.
"""
