"""Folders that are called like the function they are known for: `rr.simulate(…)` beside `robot_retarget.simulate.rollout`."""

import sys
from types import ModuleType
from typing import Any


class Stage(ModuleType):
    """A folder that can be called: it passes the call on to the public function of its own name."""

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        package, _, name = self.__name__.rpartition(".")
        return sys.modules[package].public(name)(*args, **kwargs)


def make_callable(module: str) -> None:
    """Let a folder, named by its `__name__`, be called."""
    sys.modules[module].__class__ = Stage
