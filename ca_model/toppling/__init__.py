"""The rule of Franks et al. (2019): grains are added one by one and topple until all is at rest."""
