"""Controllers with stable-baselines3's ``predict()``: baseline and trained policies; training and evaluation."""
