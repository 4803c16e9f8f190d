"""``apil bench report``: the results of benchmark directories, as data, as tables and as a page."""
