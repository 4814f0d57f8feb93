"""Linear optimal pitch in the fixed frame: the offsets, what is read of the turbine, and designs as files."""
