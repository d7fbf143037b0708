"""The command line: each file reads, calls one function, shows. Only this room prints or exits."""

from orthoglide_cal.cli.app import main
