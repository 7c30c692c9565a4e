"""A checkpoint of LeRobot as a policy."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

import numpy as np
from PIL import Image

from gvla2.component import check_ranges
from gvla2.errors import ConfigurationError, MissingDependencyError, reading
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import Observation
from gvla2_plugins.lerobot import LerobotConfig

PICTURES, STATE = "observation.images.", "observation.state"
"""LeRobot's names of what a policy sees: pictures by camera, and the arm's joints with the fingers' width."""


class LerobotPolicy:
    """Implements :class:`gvla2.robot.policy.Policy` by LeRobot's policies and processors."""

    def __init__(self, config: LerobotConfig) -> None:
        check_ranges(config, "policy", {"rate": (0.1, 1000.0, " Hz"), "seconds": (0.1, 3600.0, " s")})
        if not config.path:
            raise ConfigurationError("policy=lerobot needs a checkpoint: policy.path=FOLDER.")
        if find_spec("lerobot") is None:
            raise MissingDependencyError(
                "lerobot", "policy=lerobot", "pip install 'gvla2[lerobot]'", "Apache-2.0"
            )
        from lerobot.configs.policies import PreTrainedConfig
        from lerobot.policies.factory import get_policy_class, make_pre_post_processors

        with reading("a checkpoint of LeRobot", config.path, ConfigurationError):
            settings = PreTrainedConfig.from_pretrained(config.path)
            settings.device = config.device
            self._policy: Any = get_policy_class(settings.type).from_pretrained(config.path, config=settings)
            on_device = {"device_processor": {"device": config.device}}
            self._before, self._after = make_pre_post_processors(
                settings, config.path, preprocessor_overrides=on_device
            )
        self._settings: Any = settings
        self._instruction = ""
        self.rate, self.seconds = config.rate, config.seconds
        self.source = f"{settings.type} of {config.path}"

    def begin(self, instruction: str) -> None:
        """Start an episode."""
        self._policy.reset()
        self._before.reset()
        self._after.reset()
        self._instruction = instruction

    def act(self, observation: Observation) -> FloatArray:
        """The next action (dof + 1,), or the next of those predicted at once.

        Raises :class:`ConfigurationError` where the robot lacks one of the policy's cameras.
        """
        import torch

        images = {view.name: view.image for view in observation.views}
        state = np.append(observation.joints, observation.gripper_width).astype(np.float32)
        frame: dict[str, Any] = {STATE: torch.from_numpy(state), "task": self._instruction}
        for name, feature in self._settings.image_features.items():
            camera = name.removeprefix(PICTURES)
            if camera not in images:
                raise ConfigurationError(
                    f"The {self.source} sees by the camera '{camera}'; the robot's are {', '.join(images)}: "
                    "name those in robot.cameras=[...]."
                )
            height, width = feature.shape[1:]
            image = Image.fromarray(images[camera])
            if image.size != (width, height):
                image = image.resize((width, height), Image.Resampling.BILINEAR)
            frame[name] = torch.from_numpy(np.array(image)).permute(2, 0, 1).float() / 255.0
        with torch.inference_mode():
            action = self._after(self._policy.select_action(self._before(frame)))
        return np.asarray(action[0].cpu().numpy(), dtype=np.float64)
