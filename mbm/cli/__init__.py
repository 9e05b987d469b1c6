"""Makes calls of the Python API from a command line, and text on a terminal from what they answer."""
