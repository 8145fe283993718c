"""BVH in and out."""

from .parse import matches_format as matches_format
from .parse import parse_bvh as parse_bvh
from .parse import read as read
from .parse import read_bvh as read_bvh
from .write import write_bvh as write_bvh
