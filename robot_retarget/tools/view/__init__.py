"""Pictures, films and the report of a motion; without off-screen OpenGL figures are drawn instead of rendered."""
