"""What is plugged in, of mbm and of installed packages, as one value that is passed as an argument."""
