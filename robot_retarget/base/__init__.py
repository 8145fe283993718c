"""Arrays, errors, files and untrusted input: what every folder uses."""
