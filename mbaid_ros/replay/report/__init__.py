"""The result of replays as one HTML file that needs nothing else: no server, no network, no script."""

from mbaid_ros.replay.report.page import html

__all__ = ['html']
