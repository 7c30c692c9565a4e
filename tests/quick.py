"""Overrides of a run for tests in which nothing depends on what is seen: the true scene, one small camera."""

QUICK = ("perceiver=oracle", "robot.image_size=32", "robot.video_size=16", "robot.cameras=[front]")
