"""Labelled points of captures: markers on the skin, from which joint centres are computed, or joint centres by name."""
