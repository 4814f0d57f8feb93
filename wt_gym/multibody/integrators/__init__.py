"""Time integration: modified Hamming, Newmark, generalised-α, their limits of stability."""
