"""What leaves wt_gym and enters it: controllers as libraries, files and messages of other programs."""
