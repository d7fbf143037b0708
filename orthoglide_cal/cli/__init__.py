"""The command line: each file reads, calls one function, shows. Only it prints or exits."""

from orthoglide_cal.cli.program import main
