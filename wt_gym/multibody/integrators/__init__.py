"""Time integration: modified Hamming, Newmark, generalized-α, their limits of stability."""
