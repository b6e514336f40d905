"""Bad input of every class put to the commands: refused in one clear sentence, without traceback, hang or remains."""
