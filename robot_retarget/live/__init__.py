"""A live stream: performers' frames in, a robot's poses out, with everything around the solver.

Sources (`sources`, `receiver`, `headsets`) deliver the newest frame; `loop` has it solved and hands the pose to a sink (`sinks`).
"""
