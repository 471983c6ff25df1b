# SPDX-License-Identifier: BSD-3-Clause
"""What `bench live` measures the nodes by: layered images with the whole rate, offline, with neither congestion control
nor anything else on the link.
"""
from smokebot_udp.link_lab.channel import LinkConditions

from . import video_clips
from .live_clip import Clip
from .live_run import Cell, remembered
from .live_score import Quality, Screen, aged_as
from .quality import psnr
from .video_link import constant, watch
from .video_package import PackageVideo


def ideal(cell: Cell, screen: Screen) -> Screen:
    """The screen as it would be if each of its images had taken all of the link since the one before."""
    return aged_as(screen, _whole_rate(cell.rates[0], cell.loss, max(one.number for one in screen.taken) + 1))


def _whole_rate(rate: float, loss: float, count: int) -> Quality:
    clip, conditions = Clip(), LinkConditions(loss=loss)
    images: video_clips.Clip = [clip.image(number) for number in range(count)]
    way = PackageVideo('layered', rate, images[0], loss)
    screens = watch(images, way, constant(conditions), 1, rate).screens
    return remembered(lambda number, place: psnr(clip.image(number), screens[place]))
