"""A graph frame by frame as it comes: `stream` takes frames in, `follower` solves one performer, `realtime` takes the steps,
`home` finds the way out of a basin, `lag` smooths for those who can wait.
"""
