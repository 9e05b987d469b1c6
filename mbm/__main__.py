"""``python -m mbm``: the command line."""

from mbm.cli.main import main

if __name__ == "__main__":
    main()
