"""The tasks of `ms.evaluate`, a module each; every module of this folder is loaded when a task is asked for."""
