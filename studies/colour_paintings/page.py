"""x"""


def write_page(out): ...
