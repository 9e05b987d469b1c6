"""One clause per file: from its forms to its part of the problem."""
