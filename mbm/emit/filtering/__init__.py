"""Generated filters as plain data, before they are text in some language."""
