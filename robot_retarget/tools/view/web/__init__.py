"""The viewer: a page that is a file, is served, or is shown in the cell of a notebook."""
