"""Agents as servers for turbines under ROSCO."""
