"""A problem's clauses, evaluated against its tables, become typed equations; all static checks are here."""
