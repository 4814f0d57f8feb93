"""Bodies in local observer frames (Holm-Jørgensen et al.)."""
