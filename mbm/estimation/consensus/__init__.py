"""Equations with gross errors among them → which agree, with what weight, and how sure the estimates are then."""
