"""The free wake: rows, sheets, and what closes it behind its last row."""
