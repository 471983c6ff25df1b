# SPDX-License-Identifier: BSD-3-Clause
"""Renews the pictures of doc/experiments.md and doc/fill.md from results: python3 -m experiments.doc_pictures.

None shows a recording: those are not this project's.
"""
import cv2

from .runner import RESULTS, TOP

FOLDER = TOP / 'doc' / 'images'

PICTURES = {
    'few_segments.jpg': 'subimages/few.png',
    'more_segments.jpg': 'subimages/more.png',
    'map_reduction.png': 'map_reduction/simulated_building.png',
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
}
"""{picture in doc/images: what it is made of, in the results}"""

MOST = 150000
"""[byte]"""

WIDTHS = 1600, 1400, 1200, 1000, 800, 600
"""The widest that is small enough is taken [pixel]."""


def shrunk(image, suffix):
    """The picture as a file: uint8 array."""
    for width in WIDTHS:
        factor = min(1.0, width / image.shape[1])
        data = cv2.imencode(suffix, cv2.resize(image, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA),
                            [cv2.IMWRITE_JPEG_QUALITY, 85, cv2.IMWRITE_PNG_COMPRESSION, 9])[1]
        if len(data) <= MOST:
            return data
    raise ValueError('not even %d pixels wide it has only %d bytes' % (WIDTHS[-1], MOST))


def main():
    for name, source in PICTURES.items():
        image = cv2.imread(str(RESULTS / source))
        if image is None:
            print('%-26s stays: %s was not measured' % (name, source))
            continue
        (FOLDER / name).write_bytes(shrunk(image, (FOLDER / name).suffix).tobytes())
        print('%-26s %d bytes' % (name, (FOLDER / name).stat().st_size))


if __name__ == '__main__':
    main()
