"""Makes bytes and sources from files, and files and folders from bytes: the doors to what users have."""
