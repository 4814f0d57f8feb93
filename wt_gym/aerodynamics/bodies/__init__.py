"""What else stands in the flow: closed bodies of source panels, the tower as a cylinder."""
