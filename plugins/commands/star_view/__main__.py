"""The process that serves the page of a flight in progress."""

from star_view.live_page import main

main()
