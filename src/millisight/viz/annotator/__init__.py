"""The annotator: a page on which a person tells a segmenter by clicks what belongs to the object.

`subject` opens what is annotated, `session` answers what the page asks and saves (`coarse`: at the speed of clicks),
`server` carries it to the browser;
`page.html`, `page.css`, `page.js` and `drawing.js` are the page.
"""

from millisight.viz.annotator.server import AnnotatorServer as AnnotatorServer
from millisight.viz.annotator.session import Session as Session
from millisight.viz.annotator.session import segmenters_for as segmenters_for
from millisight.viz.annotator.subject import Subject as Subject
from millisight.viz.annotator.subject import open_subject as open_subject
