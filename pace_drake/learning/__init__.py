"""Training policies with PPO (extra ``train``: stable-baselines3, torch, onnx). Imported only when one trains."""
