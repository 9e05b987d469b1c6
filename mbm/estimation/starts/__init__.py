"""Initial values: closed forms and random starts."""
