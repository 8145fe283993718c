"""Settings of all tests: properties are judged by their truth, not by how busy the machine is.

The solver runs on the virtual machine: machine code gives the same bits and takes seconds to compile."""

import os

from hypothesis import settings

settings.register_profile("unhurried", deadline=None)
settings.load_profile("unhurried")
os.environ["CC"] = ""
