"""BVH in and out."""

from .parse import parse_bvh as parse_bvh
from .parse import read as read
from .parse import read_bvh as read_bvh
from .parse import told as told
from .write import write_bvh as write_bvh
