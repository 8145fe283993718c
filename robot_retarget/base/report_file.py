"""The content of `report.json`: its format, and the seal that binds the report to itself."""

import hashlib
import json
from collections.abc import Mapping
from typing import Any

FORMAT_VERSION = 3
"""1: of trajectories without goals. 2: without mode, thresholds and seal. `play` accepts only this one."""
NAMES = {"free": "report.json", "pinned": "report.pinned.json"}
"""File that `simulate` writes in each mode, next to the trajectory."""
SEAL = "report_sha256"


def sealed(content: Mapping[str, Any]) -> dict[str, Any]:
    """Return the content of a report with its own sha256 under `SEAL`.

    Raises:
        ValueError: a number is not finite.
    """
    plain = json.loads(json.dumps(content, allow_nan=False))
    return {**plain, SEAL: content_sha256(plain)}


def content_sha256(content: Mapping[str, Any]) -> str:
    """Return the sha256 of a report's content without its seal: of its JSON with sorted keys and no spaces.

    The seal shows that a report was edited. It holds no secret, so it does not show who wrote it.
    """
    plain = {key: value for key, value in content.items() if key != SEAL}
    text = json.dumps(plain, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()
