"""What pyproject.toml cannot say: the folder ``agents`` becomes the package ``wt_gym.agents``."""

from setuptools import find_packages, setup

agents = ["wt_gym.agents", *(f"wt_gym.agents.{name}" for name in find_packages("agents"))]
setup(
    packages=[*find_packages(include=["wt_gym", "wt_gym.*"], exclude=["wt_gym.agents"]), *agents],
    package_dir={"wt_gym.agents": "agents"},  # in place of wt_gym/agents, the way to it in a clone
)
