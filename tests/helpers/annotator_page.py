"""The annotator's page in a browser, and hands on it."""

from helpers.browser import until


class Page:
    """The annotator's page in the browser, and hands on it; places are [column, row] on the picture."""

    def __init__(self, driver, address):
        self.driver = driver
        driver.get(address)
        self.settled()
        self.canvas = driver.find_element("id", "canvas")

    def settled(self):
        """Wait until the page shows the answer to what was asked last."""
        self.until("document.body.dataset.settled === 'true'")
        self.frame()

    def frame(self):
        """Wait until the canvas is drawn anew."""
        self.driver.execute_async_script("requestAnimationFrame(() => requestAnimationFrame(arguments[0]))")

    def until(self, condition, seconds=10):
        until(self.driver, condition, seconds)

    def text(self, name):
        return self.driver.find_element("id", name).text

    @property
    def view(self):
        """Scale, left and top of the picture on the canvas."""
        return tuple(map(float, self.canvas.get_attribute("data-view").split()))

    @property
    def mask_pixels(self):
        return int(self.driver.execute_script("return document.body.dataset.maskPixels"))

    def offset(self, place):
        """Of a place's pixel from the middle of the canvas, in whole pixels of the screen."""
        scale, left, top = self.view
        size = self.canvas.size
        return (
            round(left + (place[0] + 0.5) * scale - size["width"] / 2),
            round(top + (place[1] + 0.5) * scale - size["height"] / 2),
        )

    def hand(self, place):
        from selenium.webdriver import ActionChains

        return ActionChains(self.driver, duration=0).move_to_element_with_offset(self.canvas, *self.offset(place))

    def click(self, place, *, right=False):
        hand = self.hand(place)
        (hand.context_click() if right else hand.click()).perform()
        self.settled()

    def press(self, *keys):
        from selenium.webdriver import ActionChains, Keys

        hand = ActionChains(self.driver, duration=0)
        for key in keys[:-1]:
            hand.key_down(getattr(Keys, key))
        hand.send_keys(getattr(Keys, keys[-1], keys[-1]))
        for key in keys[:-1]:
            hand.key_up(getattr(Keys, key))
        hand.perform()
        self.settled()

    def wheel(self, place, amount):
        from selenium.webdriver import ActionChains
        from selenium.webdriver.common.actions.wheel_input import ScrollOrigin

        origin = ScrollOrigin.from_element(self.canvas, *self.offset(place))
        ActionChains(self.driver, duration=0).scroll_from_origin(origin, 0, amount).perform()
        self.frame()

    def brightness(self, place):
        """Of the canvas at a place: the mean of red, green and blue."""
        scale, left, top = self.view
        x, y = left + (place[0] + 0.5) * scale, top + (place[1] + 0.5) * scale
        return self.driver.execute_script(
            "const pen = document.getElementById('canvas').getContext('2d');"
            "const [r, g, b] = pen.getImageData(arguments[0], arguments[1], 1, 1).data; return (r + g + b) / 3",
            x,
            y,
        )
