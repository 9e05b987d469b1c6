"""Experiments before they are made: from a problem to the accuracy to expect, and to what to measure next."""
