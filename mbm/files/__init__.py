"""Makes bytes and sources from files: bounded, ordinary files only; the door by which what users have comes in."""
