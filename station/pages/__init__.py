"""Pages of HTML from templates: every value is text unless it says that it is markup."""

from station.pages.render import page

__all__ = ["page"]
