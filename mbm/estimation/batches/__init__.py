"""Many solves of one problem at once: rows grouped by key, one native batch, answers in columns."""
