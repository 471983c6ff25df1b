# SPDX-License-Identifier: BSD-3-Clause
"""Renews the images of doc/experiments.md and doc/fill.md from the results: python3 -m experiments.doc_images.

None shows a recording: those do not belong to this project.
"""
import cv2

from evaluation import TOP
from smokebot_udp.arrays import UInt8Array

from .runner import RESULTS

FOLDER = TOP / 'doc' / 'images'

IMAGES = {
    'few_segments.jpg': 'subimages/few.png',
    'more_segments.jpg': 'subimages/more.png',
    'map_reduction.png': 'map_reduction/simulated_building.png',
    'map_tiles.png': 'maps/maps_time.png',
    'cloud_loss.jpg': 'cloud_loss/simulated.png',
    'cloud_loss_points.png': 'cloud_loss/points.png',
    'image_quality.png': 'image_quality/psnr.png',
    'image_quality_bursts.png': 'image_quality/bursts.png',
    'image_quality_shown.jpg': 'image_quality/shown.png',
    'adaptation.jpg': 'adaptation/adaptation.png',
    'adaptation_film.jpg': 'adaptation/film.png',
    'adaptation_switch.png': 'adaptation/switch.png',
    'virtual_scans.jpg': 'virtual_scans/simulated_000.png',
    'fill_model.png': 'fill_model/variograms.png',
    'send_order_bursts.png': 'send_order/bursts.png',
    'fill.png': '../bench/fill.png',
    'fill_sheet.jpg': '../bench/fill_sheet.jpg',
    'bandwidth.png': 'bandwidth/bandwidth.png',
    'picture_rates.png': 'pictures_per_second/rates.png',
    'picture_ages.png': 'pictures_per_second/ages.png',
    'received_packets.png': 'received_packets/packets.png',
    'cloud_points.png': 'cloud_points/points.png',
    'out_of_range.png': 'out_of_range/out_of_range.png',
    'link_cut.png': 'link_cut/link_cut.png',
    'start_up.png': 'start_up/starts.png',
    'narrow_link.png': 'narrow_link/tbf6_1_Mbit_s_5.png',
}
"""{file in doc/images: its source in the results}"""

MAX_SIZE = 150000
"""Maximum size of a file [byte]."""

WIDTHS = 1600, 1400, 1200, 1000, 800, 600
"""Widths to try, widest first. The first one whose file is small enough is used [pixel]."""


def shrunk(image: UInt8Array, suffix: str) -> UInt8Array:
    """The image as the content of a file.

    :raises ValueError: where even the narrowest exceeds MAX_SIZE
    """
    for width in WIDTHS:
        factor = min(1.0, width / image.shape[1])
        data: UInt8Array = cv2.imencode(
            suffix, cv2.resize(image, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA),
            [cv2.IMWRITE_JPEG_QUALITY, 85, cv2.IMWRITE_PNG_COMPRESSION, 9])[1]
        if len(data) <= MAX_SIZE:
            return data
    raise ValueError('at a width of %d pixels it still exceeds %d bytes' % (WIDTHS[-1], MAX_SIZE))


def main() -> None:
    """Renew all images for which there are results."""
    for name, source in IMAGES.items():
        image = cv2.imread(str(RESULTS / source))
        if image is None:
            print('%-26s unchanged: there is no %s' % (name, source))
            continue
        (FOLDER / name).write_bytes(shrunk(image, (FOLDER / name).suffix).tobytes())
        print('%-26s %d bytes' % (name, (FOLDER / name).stat().st_size))


if __name__ == '__main__':
    main()
