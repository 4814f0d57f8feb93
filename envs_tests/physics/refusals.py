"""Refusals: what raises which error."""

import pytest


def refuses(error, *cases):
    """Check that every call of the pairs (message, call) raises the error with its message, a regular expression."""
    for message, call in cases:
        with pytest.raises(error, match=message):
            call()
