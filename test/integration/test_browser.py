#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""The page in a real browser: what it shows, what it shows when something is cut, and who may look."""
import os
import pathlib
import re
import signal
import sys
import urllib.error
import urllib.request
from typing import Any, List

import numpy as np
import rostest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from browser_case import PHONE, SECONDS, TABLET, BrowserCase
from waiting import undisturbed, wait_for

from evaluation.browser import Browser

MEASURED = 'return smokebot.measured.filter((entry) => entry.stream === "thermal")'
CANVAS = 'return document.querySelector(\'[data-stream="thermal"] canvas\').toDataURL()'
GREY = 40
"""Maximum difference between the colours of a pixel that counts as grey: the edges of letters are coloured."""
MOST_BYTES, FIRST_PAINT = 150_000, 1.0
"""Maximum size of all that is loaded [byte], and maximum time until something is painted [s]."""


class Page(BrowserCase):

    def seconds(self, browser: Browser, selector: str) -> float:
        """The seconds in a text such as 'NO DATA 3.2 s'."""
        found = re.search(r'([\d.]+) s', browser.text(selector))
        self.assertIsNotNone(found, browser.text(selector))
        return float(found.group(1)) if found else 0.0

    def test_images_change_and_their_ages_are_measured(self) -> None:
        browser = self.page('viewer')
        before = browser.run(CANVAS)
        found: List[Any] = wait_for(lambda: browser.run(MEASURED)[9:], SECONDS, 'ten images')
        self.assertNotEqual(browser.run(CANVAS), before)
        stamps = [one['stamp'] for one in browser.run(MEASURED)]
        self.assertEqual(stamps, sorted(stamps))
        for one in found:
            self.assertGreater(one['added'], 0.0)
            self.assertGreater(one['age'], one['added'] - 0.01)
        self.assertLess(min(one['age'] for one in found), 1.0)
        self.assertRegex(browser.text('[data-stream="thermal"] .age'), r'^\d+\.\d+ s$')
        self.assertRegex(browser.text('[data-stream="thermal"] .unit'), 'degC')
        self.assertEqual(browser.complaints(), [])

    def test_a_viewer_has_nothing_that_commands(self) -> None:
        browser = self.page('viewer')
        self.assertFalse(any(map(browser.shown, ('#estop', '#take', '#focus', '#map-goal'))))
        self.assertTrue(browser.shown('#more-rights'))

    def test_a_cut_link_makes_images_grey_and_their_age_grow(self) -> None:
        browser = self.page('viewer')
        with self.stopped(self.pid('/robot_sender')):
            wait_for(lambda: browser.text('[data-stream="thermal"] .banner').startswith('NO DATA'), SECONDS, 'NO DATA')
            first = self.seconds(browser, '[data-stream="thermal"] .banner')
            wait_for(lambda: self.seconds(browser, '[data-stream="thermal"] .banner') > first + 1, SECONDS, 'its age')
            wait_for(lambda: 'NO LINK' in browser.text('#tiles'), SECONDS, 'NO LINK')
            self.assertEqual(browser.run('return document.querySelector(\'[data-stream="thermal"]\').dataset.state'),
                             'frozen')
            self.assertFalse(browser.shown('#silence'))     # the desk itself answers
        wait_for(lambda: self.live(browser), SECONDS, 'images again')

    def test_a_silent_desk_makes_the_page_grey(self) -> None:
        browser = self.page('viewer')
        self.assertGreater(self.colour(browser), GREY)
        with self.stopped(self.pid('/operator_web')):
            wait_for(lambda: browser.shown('#silence'), SECONDS, 'NO CONNECTION')
            self.assertIn('NO CONNECTION', browser.text('#silence'))
            first = self.seconds(browser, '#silence')
            wait_for(lambda: self.seconds(browser, '#silence') > first + 1, SECONDS, 'the seconds')
            self.assertGreater(self.seconds(browser, '[data-stream="thermal"] .banner'), 1.0)
            browser.run('document.querySelector("#silence").style.opacity = 0')
            self.assertLess(self.colour(browser), GREY)
        wait_for(lambda: self.live(browser), SECONDS, 'the page again')

    @staticmethod
    def colour(browser: Browser) -> float:
        """How colourful the screen is: 0 is grey."""
        pixels = browser.pixels().astype(int)
        return float(np.percentile(pixels.max(2) - pixels.min(2), 99.5))

    @undisturbed()
    def test_grey_comes_within_a_second_and_a_half(self) -> None:
        browser = self.page('viewer')
        browser.run('''new MutationObserver(() => { window.turned ??= performance.now(); })
                       .observe(document.body, {attributes: true, attributeFilter: ["class"]});''')
        with self.stopped(self.pid('/operator_web')):
            turned = wait_for(lambda: browser.run('return window.turned'), SECONDS, 'grey') / 1e3
            self.assertLess(turned - browser.run('return smokebot.page.connection.lastTick'), 1.5)

    def test_the_map_pans_zooms_and_follows(self) -> None:
        browser = self.page('viewer')
        wait_for(lambda: int(browser.run('return document.querySelector("#map").dataset.tiles || 0')), SECONDS, 'tiles')
        camera = 'const {x, y, scale} = smokebot.page.map.view.camera; return [x, y, scale]'
        before, picture = browser.run(camera), 'return document.querySelector("#map").toDataURL()'
        drawn = browser.run(picture)
        browser.touch('#map', (0, 0), (-40, -20), (-80, -40))
        browser.lift()
        x, y, scale = browser.run(camera)
        self.assertAlmostEqual(x - before[0], 80 / scale, delta=0.2)
        self.assertAlmostEqual(y - before[1], -40 / scale, delta=0.2)
        wait_for(lambda: browser.run(picture) != drawn, SECONDS, 'another picture')
        self.assertEqual(browser.find('#map-follow').get_attribute('aria-pressed'), 'false')
        browser.click('#map-in')
        self.assertAlmostEqual(browser.run(camera)[2], 1.5 * scale, delta=0.01)
        browser.click('#map-follow')
        wait_for(lambda: abs(browser.run(camera)[0] - before[0]) < 1, SECONDS, 'the robot in the middle')

    def test_the_status_names_the_path_to_the_robot(self) -> None:
        browser = self.page('viewer')
        browser.run('document.querySelector(\'[data-tab="status"]\').click()')
        wait_for(lambda: 'Path to /robot_sender127.0.0.1, from 127.0.0.1 by lo' in browser.text('#link-facts'), SECONDS,
                 'the path')

    def test_a_touch_of_the_thermal_image_gives_its_temperature(self) -> None:
        browser = self.page('viewer')
        browser.touch('[data-stream="thermal"] canvas', (0, 0))
        browser.lift()
        wait_for(lambda: re.match(r'[\d.-]+ degC', browser.text('.spot-text')), SECONDS, 'a temperature')

    def test_a_still_is_downloaded_with_its_numbers(self) -> None:
        browser = self.page('viewer')
        browser.run('document.querySelector(\'[data-stream="thermal"] .buttons button:nth-child(2)\').click()')
        wait_for(lambda: browser.text('#stills'), SECONDS, 'a still')
        found = browser.driver.execute_async_script('''
            const done = arguments[0], [image, numbers] = document.querySelectorAll("#stills a");
            Promise.all([fetch(image.href).then((answer) => answer.blob()),
                         fetch(numbers.href).then((answer) => answer.json())])
              .then(([blob, values]) => done([blob.type, blob.size, values]), (error) => done(String(error)))''')
        self.assertEqual(found[0], 'image/png')
        self.assertGreater(found[1], 1000)
        self.assertIn('stamp', found[2])

    def test_a_wrong_token_sees_nothing(self) -> None:
        browser = Browser(TABLET)
        self.addCleanup(browser.close)
        for fragment in ('', '#token=' + 64 * '0', '#token=%00%ff', '#token=' + self.tokens['viewer'][:-1]):
            browser.open(self.url + fragment)
            wait_for(lambda: browser.shown('#token'), SECONDS, 'the form')
            if fragment:
                wait_for(lambda: browser.text('#login-problem'), SECONDS, 'what is wrong')
            self.assertEqual(browser.run('return location.hash'), '')
            self.assertFalse(browser.shown('main') or browser.shown('header'))
            self.assertEqual(browser.run('return smokebot.measured.length + smokebot.page.robots.length'), 0)
        for path in ('ws', 'stills/1.png', 'captures/robot/x'):
            with self.assertRaises(urllib.error.HTTPError) as refused:
                urllib.request.urlopen(self.url + path, timeout=10)
            self.assertEqual((path, refused.exception.code), (path, 403))
        browser.find('#token').send_keys(self.tokens['viewer'])
        browser.click('#login-form button[type="submit"]')
        wait_for(lambda: self.live(browser), SECONDS, 'the page with the right one')

    def test_a_desk_that_starts_anew_asks_for_the_token_and_says_why(self) -> None:
        browser = self.page('viewer')
        os.kill(self.pid('/operator_web'), signal.SIGKILL)
        wait_for(lambda: browser.shown('#silence'), SECONDS, 'NO CONNECTION')
        self.start()
        wait_for(lambda: 'started anew' in browser.text('#login-text'), SECONDS, 'the form')
        browser.find('#token').send_keys(self.tokens['viewer'])
        browser.click('#login-form button[type="submit"]')
        wait_for(lambda: self.live(browser), SECONDS, 'the page again')
        self.assertFalse(browser.shown('#login'))

    def test_a_robot_that_has_another_name_is_not_shown_any_more(self) -> None:
        browser = self.page('driver')
        self.assertTrue(browser.shown('#estop') and browser.shown('[data-stream="thermal"]'))
        browser.run('''
            const {page} = smokebot, [robot] = page.robots;
            page.takeHello({type: "hello", role: "driver", tile: 128,
                            robots: ["ugv1", "ugv2"].map((name) => ({...robot, name}))});''')
        self.assertFalse(browser.shown('#estop') or browser.shown('[data-stream="thermal"]'))
        self.assertTrue(browser.shown('#robots .card'))
        browser.click('#robots .card')
        self.assertTrue(browser.shown('#estop'))

    def test_what_can_be_operated_is_named_and_large_enough(self) -> None:
        """Buttons, fields and links of each tab have a name; what fingers touch is at least 40 pixels high."""
        browser = self.page('driver', PHONE)
        for tab in ('images', 'map', 'drive', 'status', 'log', 'files'):
            browser.run('document.querySelector(\'[data-tab="%s"]\').click()' % tab)
            self.assertEqual(browser.run('''
                const named = (one) => one.getAttribute("aria-label") || one.textContent.trim() || one.labels?.[0];
                return [...document.querySelectorAll("button, select, input, a, [tabindex], summary")]
                  .filter((one) => one.checkVisibility() && (!named(one) || one.clientHeight < 40
                          && !one.closest("label, .scrolls, #log")))
                  .map((one) => one.outerHTML.slice(0, 80))'''), [], tab)
            self.assertLessEqual(browser.run('return document.documentElement.scrollWidth'), PHONE[0], tab)

    @undisturbed()
    def test_it_is_small_and_soon_painted(self) -> None:
        browser = self.page('viewer')
        size = browser.run('''
            return ["resource", "navigation"].flatMap((type) => performance.getEntriesByType(type))
              .reduce((sum, entry) => sum + (entry.transferSize || 0), 0)''')
        self.assertGreater(size, 10_000)
        self.assertLess(size, MOST_BYTES)
        painted = browser.run('return performance.getEntriesByName("first-contentful-paint")[0].startTime') / 1e3
        self.assertLess(painted, FIRST_PAINT)


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'browser', Page)
