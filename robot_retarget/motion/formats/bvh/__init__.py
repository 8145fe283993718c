"""BVH in and out."""

from .read import parse_bvh as parse_bvh
from .read import read_bvh as read_bvh
from .write import write_bvh as write_bvh
