"""RLlib's configuration of a training: the hyperparameters of stable-baselines3's names in RLlib's."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.algorithms.sac import SACConfig
from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig
from ray.tune.registry import register_env

from wt_gym.learning.distributed.rllib_environment import make_runner_env
from wt_gym.learning.training.hyperparameters import of_each_copy

if TYPE_CHECKING:
    from ray.rllib.algorithms.algorithm_config import AlgorithmConfig

    from wt_gym.learning.training.config import TrainingConfig

__all__ = ["SAMPLE_TIMEOUT", "check_settings", "rllib_config"]

SAMPLE_TIMEOUT = 1800.0
"""Time that a runner has for its part of a batch [s]. RLlib's own 60 s are shorter than a first compilation, and it
throws away what comes later."""

_ALGORITHMS, _ENV = ("PPO", "SAC"), "wt_gym"
_UNKNOWN = {  # and what may be given all the same, because it means nothing
    "PPO": {"use_sde": (False,), "sde_sample_freq": (), "target_kl": ()},
    "SAC": {"use_sde": (False,), "sde_sample_freq": (), "log_std_init": ()},
}
# Where the files leave them out: those of stable-baselines3, not RLlib's.
_DEFAULTS: dict[str, dict[str, Any]] = {
    "PPO": {"clip_range": 0.2, "ent_coef": 0.0, "vf_coef": 0.5, "max_grad_norm": 0.5, "activation_fn": "tanh"},
    "SAC": {"ent_coef": "auto", "target_entropy": "auto", "activation_fn": "relu"},
}
_LEAST_STEPS = 500  # of an iteration of SAC: between two looks at clock and signals


def check_settings(config: TrainingConfig) -> None:
    """Refuse what RLlib has not.

    Raises
    ------
    ValueError
    """
    if config.algorithm not in _ALGORITHMS:
        raise ValueError(f"with Ray the algorithm must be one of {', '.join(_ALGORITHMS)}, got {config.algorithm!r}")
    if config.budgets:
        raise ValueError(f"with Ray budgets must be left out, got {config.budgets!r}")
    values, unknown = config.resolved, _UNKNOWN[config.algorithm]
    for name, value in values.items():
        if name in unknown and value not in unknown[name]:
            raise ValueError(
                f"with Ray {name} of {config.algorithm} must be {(*unknown[name], 'left out')[0]}, got {value!r}"
            )
        if isinstance(value, str) and value.startswith("lin_") and name != "learning_rate":
            raise ValueError(f"with Ray {name} must be a number, only the learning rate can fall; got {value!r}")
    if values["normalize_observations"]:
        raise ValueError("with Ray normalize_observations must be false, got true")
    if values.get("activation_fn") == "elu":
        raise ValueError("with Ray activation_fn must be tanh or relu, got 'elu'")
    if config.algorithm == "SAC" and values.get("ent_coef", "auto") != "auto":
        raise ValueError(f"with Ray ent_coef of SAC must be auto, got {values['ent_coef']!r}")


def rllib_config(config: TrainingConfig, runners: int, session: int) -> AlgorithmConfig:
    """Configuration of RLlib's new API stack.

    Parameters
    ----------
    config : TrainingConfig
    runners : int
        Processes that step the environments, which divide among them; 0: the one that learns.
    session : int
        Steps done before: a resumed training meets other winds than it began with.

    Raises
    ------
    ValueError
        If the environments cannot be divided, or RLlib lacks a hyperparameter.
    """
    check_settings(config)
    envs, rest = divmod(config.n_envs, max(1, runners))
    if rest or not envs:
        raise ValueError(f"{config.n_envs} environments cannot be divided among {runners} runners")
    values = _DEFAULTS[config.algorithm] | of_each_copy(config.resolved, config.n_envs)
    register_env(_ENV, make_runner_env)  # by Ray, in every process that asks for it
    settings, fragment = (_ppo if config.algorithm == "PPO" else _sac)(values, config, runners)
    context = {
        "env_id": config.env_id,
        "env_kwargs": config.env_kwargs,
        "mark": [config.seed, session],
        "gamma": values["gamma"] if values["normalize_rewards"] else None,
    }
    return (
        settings.environment(
            _ENV,
            env_config=context,
            normalize_actions=config.algorithm == "SAC",  # its squashed actions lie in -1 to 1
            clip_actions=True,  # as stable-baselines3: the environment refuses what lies outside
        )
        .framework("torch")
        .env_runners(
            num_env_runners=runners,
            num_envs_per_env_runner=envs,
            gym_env_vectorize_mode="vector_entry_point",
            rollout_fragment_length=fragment,
            sample_timeout_s=SAMPLE_TIMEOUT,
        )
        .fault_tolerance(restart_failed_env_runners=True)
        .rl_module(
            model_config=DefaultModelConfig(
                fcnet_hiddens=list(values["net_arch"]),
                fcnet_activation=values["activation_fn"],
                head_fcnet_hiddens=[],
                vf_share_layers=False,
                free_log_std=config.algorithm == "PPO",
            )
        )
        .debugging(seed=config.seed, log_level="ERROR")
    )


def _rate(value: Any, steps: int) -> Any:
    """Learning rate, or RLlib's schedule of one that falls to zero over the training."""
    if isinstance(value, str):
        return [[0, float(value.removeprefix("lin_"))], [steps, 0.0]]
    return value


def _ppo(values: dict[str, Any], config: TrainingConfig, runners: int) -> tuple[AlgorithmConfig, int]:
    """PPO without what stable-baselines3's has not: no penalty of the divergence, no clipping of values."""
    settings = PPOConfig().training(
        lr=_rate(values["learning_rate"], config.total_steps),
        gamma=values["gamma"],
        lambda_=values["gae_lambda"],
        train_batch_size_per_learner=values["n_steps"] * config.n_envs,
        minibatch_size=min(values["batch_size"], values["n_steps"] * config.n_envs),
        num_epochs=values["n_epochs"],
        clip_param=values["clip_range"],
        entropy_coeff=values["ent_coef"],
        vf_loss_coeff=values["vf_coef"],
        vf_clip_param=float("inf"),
        use_kl_loss=False,
        grad_clip=values["max_grad_norm"],
        grad_clip_by="global_norm",
    )
    return settings, values["n_steps"]


def _sac(values: dict[str, Any], config: TrainingConfig, runners: int) -> tuple[AlgorithmConfig, int]:
    """SAC from a plain buffer, with as many updates after as many steps as stable-baselines3's."""
    fragment, batch = values["train_freq"], values["batch_size"]
    rate = _rate(values["learning_rate"], config.total_steps)
    sampled = fragment * config.n_envs
    updates = sampled if values["gradient_steps"] < 0 else values["gradient_steps"]
    # RLlib takes "intensity / native ratio" updates a round, and counts one runner too many in the ratio
    native = batch / (fragment * (config.n_envs // max(1, runners)) * (runners + 1))
    settings = (
        SACConfig()
        .training(
            actor_lr=rate,
            critic_lr=rate,
            alpha_lr=rate,
            lr=None,
            gamma=values["gamma"],
            tau=values["tau"],
            train_batch_size_per_learner=batch,
            training_intensity=updates * native,
            num_steps_sampled_before_learning_starts=values["learning_starts"],
            target_entropy=values["target_entropy"],
            replay_buffer_config={"type": "EpisodeReplayBuffer", "capacity": values["buffer_size"]},
        )
        .reporting(min_time_s_per_iteration=0, min_sample_timesteps_per_iteration=min(_LEAST_STEPS, config.total_steps))
    )
    return settings, fragment
