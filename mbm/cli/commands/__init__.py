"""One command per file; each is imported only when it is called, so that ``mbm --help`` stays quick."""
