"""Train a policy with Stable-Baselines3 through the Gymnasium adapter (extra ``train``).

``pace train`` does this with better settings, and exports the result; this is the bare adapter for your own method.

    python examples/train.py [decisions]
"""

import sys

import gymnasium
from stable_baselines3 import PPO
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor

import pace_drake  # noqa: F401  registers the environment


def run(decisions: int) -> float:
    env = gymnasium.make("PaceAssembly-v0", split="train")
    # Steps differ in duration, so nothing is discounted: the return of an episode is minus its cost.
    model = PPO("MlpPolicy", env, gamma=1.0, n_steps=256, batch_size=64, seed=0, device="cpu")
    model.learn(decisions)
    mean, _ = evaluate_policy(model, Monitor(gymnasium.make("PaceAssembly-v0")), n_eval_episodes=10)
    print(f"mean cost of 10 episodes: {-mean:.1f} s")
    return -mean


if __name__ == "__main__":
    run(int(sys.argv[1]) if len(sys.argv) > 1 else 2048)
