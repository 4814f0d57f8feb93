"""wt_gym.structure"""
