"""Makes forms from characters: source, spans, the reader, the printer, the formatter, and diagnostics as text."""
