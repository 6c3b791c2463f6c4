"""The design problem without any domain: what responds, what is measured, how it is judged and scored."""
