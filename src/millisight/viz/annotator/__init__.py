"""The annotator: a page on which a person tells a segmenter by clicks what belongs to the object.

`_subject` opens what is annotated, `_annotation` answers what the page asks and saves,
`_server` carries it to the browser; `page.html`, `page.css`, `page.js` and `drawing.js` are the page.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
