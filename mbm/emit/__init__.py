"""KernelSet → files: solvers that leave the house. One package for each target language."""
