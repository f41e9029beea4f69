"""Signatures and help of the commands, in the groups of `auvid --help`.

Heavy modules are imported by the command that needs them, so that help and refusals
are quick.
"""
