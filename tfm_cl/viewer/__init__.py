"""The viewer: sessions that follow what a page says, and send it pictures.

In a notebook it is `tfm_cl.viewer.widget.view`, which users know as ``tfm.view``.
"""
