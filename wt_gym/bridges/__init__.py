"""What comes in and what goes out: codes and controllers of the industry behind the contracts of this package."""
