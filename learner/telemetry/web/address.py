"""The address of the page."""

from functools import partial

from common.process.http_endpoints import check_address

check_web_address = partial(check_address, flag="--web", usual="127.0.0.1:8080", least_port=0)
"""As `check_address`, where port 0 stands for any that is free."""
