"""The target language. So far its innermost part: straight-line programs in single-assignment form."""
