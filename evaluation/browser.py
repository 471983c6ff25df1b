# SPDX-License-Identifier: BSD-3-Clause
"""A real browser without a screen: chromium, driven by chromedriver and selenium."""
import importlib.util
import os
import shutil
import tempfile
import time
from typing import Any, Dict, List, Tuple

import cv2
import numpy as np
import psutil

from smokebot_udp.arrays import UInt8Array

OPTIONS = ('--headless=new', '--hide-scrollbars', '--disable-background-networking', '--no-first-run', '--mute-audio',
           '--disable-component-update', '--disable-dev-shm-usage')


def missing() -> str:
    """What is not installed that a Browser needs; empty: nothing."""
    found = [name for name in ('chromium', 'chromedriver') if not shutil.which(name)]
    if importlib.util.find_spec('selenium') is None:
        found.append('python3-selenium')
    return ', '.join(found)


class Browser:
    """A window of its own browser, with its own cookies. Lives until `close`.

    :param size: (width, height) of the page [CSS pixel]
    :param ratio: device pixels for each of them
    """

    def __init__(self, size: Tuple[int, int], ratio: float = 1.0) -> None:
        from selenium import webdriver
        from selenium.webdriver.chrome.service import Service
        options = webdriver.ChromeOptions()
        self._folder = tempfile.TemporaryDirectory(prefix='browser_')
        for option in (*OPTIONS, '--user-data-dir=' + self._folder.name):
            options.add_argument(option)
        if os.getuid() == 0:    # chromium refuses its sandbox to root
            options.add_argument('--no-sandbox')
        options.binary_location = shutil.which('chromium') or ''
        options.set_capability('goog:loggingPrefs', {'browser': 'ALL'})
        self.driver = webdriver.Chrome(options=options, service=Service(shutil.which('chromedriver') or ''))
        self.driver.set_script_timeout(30)
        self.driver.execute_cdp_cmd('Emulation.setTouchEmulationEnabled', {'enabled': True, 'maxTouchPoints': 5})
        self.resize(size, ratio)

    def resize(self, size: Tuple[int, int], ratio: float = 1.0) -> None:
        """Give the page a size [CSS pixel]."""
        self.driver.execute_cdp_cmd('Emulation.setDeviceMetricsOverride', {
            'width': size[0], 'height': size[1], 'deviceScaleFactor': ratio, 'mobile': False})

    def open(self, url: str) -> None:
        """Load a page, as if none had been loaded before: with another fragment alone it would stay."""
        self.driver.get('about:blank')
        self.driver.get(url)

    def run(self, script: str, *arguments: Any) -> Any:
        """What a script returns."""
        return self.driver.execute_script(script, *arguments)

    def find(self, selector: str) -> Any:
        """The first element of a CSS selector."""
        return self.driver.find_element('css selector', selector)

    def text(self, selector: str) -> str:
        """The text of an element, also of one that is not displayed."""
        return str(self.run('return document.querySelector(arguments[0]).textContent', selector))

    def shown(self, selector: str) -> bool:
        """Whether an element exists and is displayed."""
        return any(element.is_displayed() for element in self.driver.find_elements('css selector', selector))

    def click(self, selector: str) -> None:
        """Click an element."""
        self.find(selector).click()

    def touch(self, selector: str, *places: Tuple[float, float]) -> None:
        """Put a finger on an element and move it from place to place, without lifting it.

        :param places: (x, y) from the element's middle [CSS pixel]
        """
        left, top = self.run('''
            const element = document.querySelector(arguments[0]);
            element.scrollIntoView({block: "nearest"});
            const box = element.getBoundingClientRect();
            return [box.left + box.width / 2, box.top + box.height / 2]''', selector)
        for number, (x, y) in enumerate(places):
            self._finger('touchMove' if number else 'touchStart', {'x': left + x, 'y': top + y})

    def lift(self) -> None:
        """Lift the finger."""
        self._finger('touchEnd')

    def pixels(self) -> UInt8Array:
        """What is on the screen: (height, width, 3) uint8, bgr."""
        image: UInt8Array = cv2.imdecode(np.frombuffer(self.driver.get_screenshot_as_png(), np.uint8), cv2.IMREAD_COLOR)
        return image

    def complaints(self) -> List[str]:
        """What the browser has logged since the last call, such as what a Content-Security-Policy forbids."""
        return [entry['message'] for entry in self.driver.get_log('browser') if entry['level'] in ('SEVERE', 'WARNING')]

    def processes(self) -> List[Any]:
        """The processes of the browser, without the driver's."""
        return psutil.Process(self.driver.service.process.pid).children(recursive=True)

    def usage(self, seconds: float) -> float:
        """Processor time that the browser uses for each second, over a time [s]."""
        def used() -> float:
            return sum(sum(process.cpu_times()[:2]) for process in self.processes())
        begun, before = time.monotonic(), used()
        time.sleep(seconds)
        return (used() - before) / (time.monotonic() - begun)

    def close(self) -> None:
        """End the browser."""
        self.driver.quit()
        self._folder.cleanup()

    def _finger(self, event: str, *places: Dict[str, float]) -> None:
        self.driver.execute_cdp_cmd('Input.dispatchTouchEvent', {'type': event, 'touchPoints': places})
