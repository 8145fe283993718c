"""CasADi's operators are overloaded beyond what its own module tells a type checker: every name is taken as it is."""

from typing import Any

def __getattr__(name: str) -> Any: ...
