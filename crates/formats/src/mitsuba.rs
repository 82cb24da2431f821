//! Mitsuba 3's XML.

mod xml;
