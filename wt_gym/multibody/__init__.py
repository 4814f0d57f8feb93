"""wt_gym.multibody"""
