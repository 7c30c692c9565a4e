"""Stable-Baselines3 learns to bring the hand over the block, by small changes of the joints, 20 a second.

    python examples/07_reinforcement_learning.py [STEPS [EPISODES]]

Sparse success alone teaches little, so the wrapper adds what a trainer would: a reward for coming closer. Some three
minutes of a processor for 40,000 steps; EPISODES judge it, 20 by default. Needs `pip install "gvla2[sim,gym,rl]"`.
"""

import sys

import gymnasium
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env

ABOVE, NEAR = 0.10, 0.04  # metres above the block's middle, and how near the hand must come to that point
SPAN = 0.2  # metres that the network sees as 1
SECONDS = 2.5


class Reach(gymnasium.Wrapper):
    """Task of its own on the block of `put_block`: be above it. The observation is where to go, and the joints."""

    def __init__(self):
        options = {"control": "joint_delta", "obs_mode": "state", "max_episode_steps": int(20 * SECONDS)}
        super().__init__(gymnasium.make("gvla2.gym:gvla2/put_block-v0", **options))
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (7,), np.float32)
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (10,), np.float32)

    def reset(self, **chosen):
        seen, info = self.env.reset(**chosen)
        return self._seen(seen), info

    def step(self, action):
        seen, _, _, truncated, info = self.env.step(np.append(action, 1.0))
        mine = self._seen(seen)
        away = SPAN * float(np.linalg.norm(mine[:3]))
        info["is_success"] = away < NEAR
        return mine, float(away < NEAR) - away, False, truncated, info

    def _seen(self, seen):
        to_go = seen["bodies"][0, :3] + [0.0, 0.0, ABOVE] - seen["tcp"][:3]
        return np.concatenate([to_go / SPAN, seen["joints"]]).astype(np.float32)


def share_reached(act, episodes):
    """How many of fresh layouts end above the block."""
    env, reached = Reach(), 0
    for seed in range(10_000, 10_000 + episodes):
        seen, _ = env.reset(seed=seed)
        over = False
        while not over:
            seen, _, _, over, info = env.step(act(seen))
        reached += info["is_success"]
    env.close()
    return reached / episodes


def main():
    steps = int(sys.argv[1]) if len(sys.argv) > 1 else 40_000
    episodes = int(sys.argv[2]) if len(sys.argv) > 2 else 20
    torch.set_num_threads(1)  # the network is small: more threads wait for one another
    envs = make_vec_env(Reach, n_envs=2, seed=0)
    model = PPO(
        "MlpPolicy", envs, n_steps=min(512, steps // 2), batch_size=min(256, steps), gamma=0.9, learning_rate=1e-3,
        seed=0, device="cpu", policy_kwargs={"log_std_init": -1.0},
    )  # fmt: skip
    rng = np.random.default_rng(0)
    share = share_reached(lambda seen: rng.uniform(-1, 1, 7), episodes)
    print(f"before: {share:.0%} reached by actions at random")
    model.learn(steps, progress_bar=False)
    share = share_reached(lambda seen: model.predict(seen, deterministic=True)[0], episodes)
    print(f"after {steps} steps: {share:.0%} reached")
    envs.close()


if __name__ == "__main__":
    main()
