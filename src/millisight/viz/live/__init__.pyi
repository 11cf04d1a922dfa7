from ._live_page import LivePage as LivePage
