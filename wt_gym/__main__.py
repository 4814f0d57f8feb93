"""``python -m wt_gym``: the command line where ``wt-gym`` is not on the path."""

from wt_gym.commands import main

if __name__ == "__main__":
    main()
