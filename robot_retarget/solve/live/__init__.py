"""Solve a graph one frame at a time, as frames arrive.

`stream` receives frames, `follower` solves one performer, `realtime` takes the steps, `home` finds the way out of a
basin, `lag` smooths for applications that can wait.
"""
