"""The version of the package, which reports and batches state."""

VERSION = "0.3.0"
