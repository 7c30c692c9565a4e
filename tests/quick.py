"""Overrides of an episode for tests that ask neither what is seen nor what is shown."""

BLINK = ("robot.image_size=32", "robot.video_size=16", "robot.cameras=[front]")
"""Small pictures of one camera."""
QUICK = ("perceiver=oracle", *BLINK)
"""The scene as it is, whatever the pictures show."""
