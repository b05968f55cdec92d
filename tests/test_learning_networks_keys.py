"""Sizes of the networks, their defaults and limits: those of the page that tells them."""

from learning.keys import at_once_table, network_table
from tests.pages import ROOT

PAGE = (ROOT / "docs" / "network.md").read_text()


def test_every_size_has_the_default_and_the_limits_that_the_docs_tell():
    assert network_table() in PAGE and at_once_table() in PAGE
