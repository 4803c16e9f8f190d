"""``apil bench report``: what benchmark directories hold, as evidence, as tables and as a page."""
