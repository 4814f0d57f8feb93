"""Agents and controllers in winds: runs, comparisons, reports, benchmark tasks, load cases."""
