"""What evaluates kernels, one backend per file, each exporting ``BACKEND``."""
