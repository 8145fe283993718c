"""Solve a graph one frame at a time, as frames arrive.

`stream` receives frames, `follower` solves one performer, `realtime` takes the steps, `basin_escape` finds the way out of a
basin, `lag` smooths for applications that can wait.
"""
