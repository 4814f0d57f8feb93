#!/usr/bin/env python3
"""``wt-gym export`` of this clone, whether it is installed or not."""

import use_venv  # noqa: F401 - finds packages and interpreter

from wt_gym.commands.export import main

if __name__ == "__main__":
    main()
