"""Overrides of an episode for tests that ask neither what is seen nor what is shown."""

BLINK = ("robot.image_size=32", "robot.video_size=16", "robot.video_fps=1", "robot.cameras=[front]")
"""Small pictures of one camera, and a film of one frame a second."""
QUICK = ("perceiver=oracle", *BLINK)
"""The scene as it is, whatever the pictures show."""
