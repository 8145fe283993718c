"""Files from somewhere else, read as data: nothing in them runs, and none takes more memory than its limit.

`unpack` reads bytes, compressed or in a zip; `arrays` reads NumPy's files; `pickles` reads pickles of Python, joblib and
PyTorch; `fields` checks arrays by kind, shape and bounds. All raise `FileError`.
"""
